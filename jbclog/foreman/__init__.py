"""THE FOREMAN. Carries a batch out: starts jobs when it is their turn, follows them, writes down what came of them.

Owns: the processes of jobs, who holds a batch, what is done about one that was half done, the end in good order.
Never: speaks to a station: each job is a process of its own that does what `jbclog run` does, with its own guard, and goes on
when the foreman dies.
May use: `batch`, `job`, `plan`, `dossier`, `drive`, `record`, `recipe`, `outcome`, `session`, `rows`, `foreign` and `errors`.
Start reading: `work.py`; then `hands.py`, the processes, and `child.py`, what one of them does.
"""
