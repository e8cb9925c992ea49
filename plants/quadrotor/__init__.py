"""A Crazyflie-class quadrotor in MuJoCo, held up and steered by the cascaded PID of its firmware."""
