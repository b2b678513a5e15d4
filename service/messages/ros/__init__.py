"""What ROS 2 nodes receive: sensor_msgs and the like, as CDR."""
