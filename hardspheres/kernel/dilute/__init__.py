"""The search of dilute gases: windows of time, and the trajectory segments in them."""
