"""Many drives on Dask, and one table of the drives."""

from farpoint.fleet.cluster import ClusterOptions
from farpoint.fleet.drive import Drive
from farpoint.fleet.fleet import FleetOutcome, run_fleet
from farpoint.fleet.manifest import ListedDrive, list_drives

__all__ = ["ClusterOptions", "Drive", "FleetOutcome", "ListedDrive", "list_drives", "run_fleet"]
