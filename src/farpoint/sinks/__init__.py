"""Where results go: files and pictures, each written as the run goes."""
