"""What our own studies need beside `desplat_ns.studies.grid`: scenes, a command, tables."""
