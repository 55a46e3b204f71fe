"""Links between a recorder and a station: ports, cables with bits, noise, floods."""
