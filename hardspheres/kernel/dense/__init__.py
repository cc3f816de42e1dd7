"""The search of dense gases: cells, neighbour lists, and a calendar of each particle's next event."""
