"""Hard cases, kills, a long run and mutations: `make stability`."""
