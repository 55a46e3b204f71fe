"""Virtual stations: runs in memory on a clock that jumps, and lines served to a process."""
