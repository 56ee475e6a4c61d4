"""What our own studies need beside `desplat_ns.studies`: scenes, a command, tables."""
