"""Every number of the odometry that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known.
"""

from __future__ import annotations

# Number of changes of the angular velocity that are averaged. Chosen: a second of most videos.
AVERAGED_CHANGES = 30

# Number of time stamps to which a line is fitted, at most. Chosen.
MAX_STAMPS = 60

# Least number of time stamps for the test whether the period varies. Fewer time stamps are taken as
# of a constant period. Chosen.
MIN_STAMPS = 15

# Root mean square of the departures of intervals from multiples of the period, over the period.
# Below, time stamps are used unchanged. Chosen.
NO_JITTER = 1e-6

# Largest departure of an interval from a multiple of the period, over the period. Beyond, time
# stamps are used unchanged. Chosen.
MAX_INTERVAL_DEPARTURE = 0.35

# Constant period: largest root mean square departure of time stamps from the line, over the root
# mean square departure of intervals from multiples of the period. Derived: between 0.71 for
# constant periods, and above 1 for varying ones.
MAX_DEPARTURE_RATIO = 0.85

# Largest correlation of successive intervals of a constant period. Derived: between -0.5 for
# constant periods, and 0 for varying ones.
MAX_INTERVAL_CORRELATION = -0.25

# Interval between two frames before the first interval is known, s. Convention: 10 frames per
# second.
FIRST_INTERVAL_S = 0.1

# Weight of the initial split-half ratio, in pairs of frames. Chosen.
FIRST_RATIO_PAIRS = 2

# Largest weight of the mean split-half ratio, in pairs: older pairs are forgotten exponentially.
# Chosen.
MAX_RATIO_PAIRS = 100

# False-alarm rate of the test whether the path's lens differs from the lens in use. Convention:
# that of 3 sigma.
LENS_CHANGE_FALSE_ALARM = 0.0027

# Offset between the random numbers of splits for successive values of `OdometryOptions.seed`, in
# frames: `Odometry.split_half` uses the seed ``frame1 + FRAMES_PER_SEED * seed``. Chosen.
FRAMES_PER_SEED = 1_000_000

# Number of first frames that call kernels for the first time in a process. Derived: frame 0 detects
# corners, frame 1 tracks and estimates, and frame 2 predicts.
FRAMES_WITH_NEW_KERNELS = 3
