"""Every number of the odometry that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known.
"""

from __future__ import annotations

# Number of changes of the angular velocity that are averaged. Chosen: a second of most videos.
AVERAGED_CHANGES = 30

# Number of time stamps to which a line is fitted, at most. Chosen.
MAX_STAMPS = 60

# Least number of time stamps that show that their period varies. Chosen.
MIN_STAMPS = 15

# Jitter of time stamps over their period up to which there is none. Chosen.
NO_JITTER = 1e-6

# Largest departure of an interval from a multiple of the period, over the period. Chosen.
MAX_INTERVAL_DEPARTURE = 0.35

# Largest root mean square of the departures from the line, over that of intervals, of a constant
# period. Derived: between 0.71 for constant periods, and above 1 for varying ones.
MAX_DEPARTURE_RATIO = 0.85

# Largest correlation of successive intervals of a constant period. Derived: between -0.5 for
# constant periods, and 0 for varying ones.
MAX_INTERVAL_CORRELATION = -0.25

# Interval of two frames before the first one is known, s. Convention: 10 frames per second, as
# elsewhere.
FIRST_INTERVAL_S = 0.1

# Weight of the initial split-half ratio, in pairs of frames. Chosen.
FIRST_RATIO_PAIRS = 2

# Largest weight of the mean split-half ratio, in pairs: older pairs are forgotten exponentially.
# Chosen.
MAX_RATIO_PAIRS = 100

# False-alarm rate of a change of the lens. Convention: that of 3 sigma.
LENS_CHANGE_FALSE_ALARM = 0.0027

# Frames per seed with different random splits. Chosen.
FRAMES_PER_SEED = 1_000_000

# Number of frames whose kernels are usually new to a process. Derived: frame 0 detects corners, 1
# tracks and estimates, and 2 predicts.
FRAMES_WITH_NEW_KERNELS = 3
