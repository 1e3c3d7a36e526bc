"""One script for each thing that Guise must reach; each prints what was measured beside the target."""
