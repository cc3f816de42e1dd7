"""Running: independent replicas over processes, saved so that an interrupted study can go on.

In reading order:

- `ensemble`: seeds, worker processes, results in order;
- `resuming`: a replica that saves its state now and then, and goes on from it;
- `stopping`: signals, held back while something is saved;
- `journal`: the checkpoint folder of a study;
- `encoding`: what is saved, to a file and back, to the last bit;
- `locking`: one run at a time writes into a folder;
- `ownership`: which files there are ours to replace.
"""
