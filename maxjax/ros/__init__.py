"""The loop on board as a ROS 2 node: clouds and odometry in, verified paths and motions out."""
