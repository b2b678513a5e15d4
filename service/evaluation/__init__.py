"""What `lidarboost evaluate` adds to the experiments: true maps from files, tables and pictures."""
