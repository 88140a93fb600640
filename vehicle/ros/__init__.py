"""ROS 2 without ROS: topics of a drive in a ROS 2 graph, and the messages as a ROS 2 package."""
