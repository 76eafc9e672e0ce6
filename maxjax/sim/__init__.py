"""One flight in closed loop: vehicle, controller, sensors, rolling map, replanning."""
