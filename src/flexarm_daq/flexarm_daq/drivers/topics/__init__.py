"""Rig that is a ROS 2 robot: joint states and other sensors come by topics, efforts go by one."""
