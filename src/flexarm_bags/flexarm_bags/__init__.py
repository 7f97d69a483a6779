"""The rosbag2 format over MCAP, without ROS: writing, reading, checks, repair, playback."""
