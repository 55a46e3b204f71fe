"""Three hundred seeded histories of runs, lived by two versions of jbclog on the independent
stations of `oracles.outside_bench`, and compared: the older version is the oracle of the newer.

::

    drawn        what happens in history 0 to 299: stations, recipes, faults, rate, end
    benches      stations and wires to which that happens
    product      records one history; the only part that names anything inside jbclog, so each
                 version is run with the file of its own tree
    live         the same with real processes, real ports and the guard
    normal       what is written of a run, and what of it must differ between two runs
    driver       the driver: histories in, JSON lines out
    compare      two folders of JSON lines: where they differ first

`.ci/oracle` makes an environment for each version and runs driver and comparison.
"""
