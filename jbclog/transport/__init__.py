"""Serial ports, and the drivers that run sessions: reactor, blocking, virtual clock. The only
package that imports `serial`.

Start with `port.py` and `opening.py`, then `blocking.py`, the shortest driver; `reactor.py` drives
hundreds of stations.
"""
