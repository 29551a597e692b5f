"""The stages on a project folder, in order, with resume and a run record."""
