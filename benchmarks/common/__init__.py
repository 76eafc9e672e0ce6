"""What benchmarks and experiments share: timing, result files, tables, problems, judges and peers."""
