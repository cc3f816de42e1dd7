"""Running: independent replicas over processes, saved so that an interrupted study can be resumed.

In reading order:

- `ensemble`: seeds, worker processes, results in order;
- `processes`: how worker processes start, heed signals, and end;
- `forking`: the process that workers are forks of;
- `resuming`: a replica that saves its state at intervals, and resumes from it;
- `stopping`: signals, deferred while something is saved;
- `journal`: the checkpoint folder of a study;
- `encoding`: values to a file and back, bit for bit;
- `locking`: at most one run writes into a folder;
- `ownership`: which files a run may replace.
"""
