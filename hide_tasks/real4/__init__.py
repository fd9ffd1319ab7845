"""Suite `real4`: the four tasks of the paper's real robot, with its one external camera."""
