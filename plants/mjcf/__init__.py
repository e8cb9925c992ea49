"""A plant from any MuJoCo model file."""
