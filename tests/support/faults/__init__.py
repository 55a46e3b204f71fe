"""One fault each: damaged files, processes killed at a step, disks, clocks and memory that fail."""
