"""Parts of a surface told apart: coil, stalk, substrate and specimen; cuts by hand; masks."""
