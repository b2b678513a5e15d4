"""The key space of ROS 2 nodes under rmw_zenoh."""
