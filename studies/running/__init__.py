"""Running: independent replicas over processes, saved so that an interrupted study can be resumed.

In reading order:

- `ensemble`: seeds, worker processes, results in order;
- `processes`: how worker processes start, heed signals, and end;
- `forking`: the process that workers are forks of;
- `executors`: threads, Dask and MPI by name;
- `elsewhere`: replicas over these, or any other executor;
- `resuming`: a replica that saves its state at intervals, and resumes from it;
- `stopping`: signals, deferred while something is saved;
- `journal`: the checkpoint folder of a study;
- `kept`: replicas that stay after a study is finished, to be extended or combined;
- `encoding`: values to a file and back, bit for bit;
- `locking`: at most one run writes into a folder, or several shards of one;
- `shards`: processes that each run a part of a study into one folder; `presence`: whether they still run;
- `ownership`: which files a run may replace;
- `ours`: whether this process is the command line's own; `garbage`: when our processes collect it.
"""
