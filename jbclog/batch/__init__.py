"""BATCHES. A queue of jobs: what its file asks for, what may begin when, and the journal that it is gone on with from.

Owns: the jobs file, times of day, whose turn it is, the journal's lines and what stands by them, the papers of each job.
Never: starts or ends anything, speaks to a station, knows the command line.
May use: `recipe`, `record`, `commands`, `rows`, `locked`, `foreign` and `errors`.
Start reading: `queue.py`, what comes next; `standing.py`, what the journal says; then `jobs_file.py`.
"""
