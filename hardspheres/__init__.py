"""Event-driven gases of hard spheres."""
