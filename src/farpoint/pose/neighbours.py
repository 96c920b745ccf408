"""Matches that err as their neighbours do, as those of one surface may: no noise of their own."""

from __future__ import annotations

from dataclasses import replace

from farpoint._kernels.covariance import growth_by_few
from farpoint._kernels.sharing import LIKELY
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit

__all__ = ["doubt_where_alike"]

# Likeness of neighbours that is plainly no noise: that of noise exceeds it 0.3 times in a hundred.
PLAIN = 3.0
# Of errors that are smooth over more of the image than a quarter of its width and height, its parts
# do not see all: as a factor, by rendered streets that OpenCV's Lucas-Kanade followed.
BEYOND = 1.5
# Degrees of freedom of what so few parts tell, by how it scatters there.
FREEDOM = 12.0


def doubt_where_alike(matches: Matches, fit: MovingFit) -> tuple[Matches, MovingFit]:
    """The matches and their fit, which count what neighbours share; in doubt where much is plain.

    Where nothing was told of the noise. Hundreds of matches of a few surfaces tell less than as
    many with noise of their own. Who takes them for such is too sure of the motion, of a
    translation, and of which of two motions it was.
    """
    if matches.doubt > 1.0 or fit.likeness < LIKELY:
        return matches, fit
    sharing = max(growth_by_few(FREEDOM) * BEYOND * fit.design_effect, 1.0)
    in_doubt = fit.likeness > PLAIN
    told = fit.matches.that_share(sharing, in_doubt=in_doubt)
    return matches.that_share(sharing, in_doubt=in_doubt), replace(fit, matches=told)
