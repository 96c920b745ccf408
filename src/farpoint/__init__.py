"""farpoint: camera motion from any two images, with an honest covariance."""

__version__ = "0.1.0"
