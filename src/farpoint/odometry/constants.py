"""Named constants of `farpoint.odometry`: meaning, unit and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known.
"""

from __future__ import annotations

# Largest number of changes of the velocity whose mean square is computed. Chosen: 1 s of most
# videos.
AVERAGED_CHANGES = 30

# 1-sigma of a coordinate of the angular acceleration before any change was measured, rad/s^2.
# Measured: root mean square of the second differences of orientations 1/30 s apart, 1.4 to 7.9 in
# recordings by hand (TUM-VI rooms 1 and 2) and by racing drones (UZH-FPV indoor forward 5 and 7).
ANGULAR_ACCELERATION = 5.0

# 1-sigma of a coordinate of the rate at which the direction of translation turns, before any turn
# was measured, rad/s. Measured: 0.5 to 2.5 in the same recordings.
DIRECTION_TURN_RATE = 2.0

# Largest number of time stamps to which a line is fitted. Chosen.
MAX_STAMPS = 60

# Least number of time stamps for the test whether the period varies. With fewer time stamps, the
# period is assumed to be constant. Chosen.
MIN_STAMPS = 15

# Root mean square departure of intervals from multiples of the period, divided by the period, below
# which time stamps are used unchanged. Chosen.
NO_JITTER = 1e-6

# Departure of any interval from a multiple of the period, divided by the period, above which time
# stamps are used unchanged. Chosen.
MAX_INTERVAL_DEPARTURE = 0.35

# Largest ratio, for a constant period, of the root mean square departure of time stamps from the
# line to the root mean square departure of intervals from multiples of the period. Derived: the
# ratio is 0.71 for constant periods and above 1 for varying periods.
MAX_DEPARTURE_RATIO = 0.85

# Largest correlation of successive intervals for a constant period. Derived: the correlation is
# -0.5 for constant periods and 0 for varying periods.
MAX_INTERVAL_CORRELATION = -0.25

# Interval between two frames before the first interval is known, s. Convention: 10 frames per
# second.
FIRST_INTERVAL_S = 0.1

# False-alarm rate of the test whether the path's lens differs from the lens in use. Convention: the
# probability that a normal error exceeds 3 sigma.
LENS_CHANGE_FALSE_ALARM = 0.0027

# `Odometry.split_half` uses the random seed ``frame1 + FRAMES_PER_SEED * OdometryOptions.seed``, so
# that two values of the option have no random seed in common for videos of fewer frames. Chosen.
FRAMES_PER_SEED = 1_000_000

# Only the first frames of a process, in this number, can call a kernel for the first time. Derived:
# frame 0 detects corners, frame 1 tracks and estimates, and frame 2 predicts.
FRAMES_WITH_NEW_KERNELS = 3
