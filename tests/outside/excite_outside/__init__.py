"""What a package outside adds to excite, one file each."""
