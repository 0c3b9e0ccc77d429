"""What benchmarks share: rates, bare loops to compare with, tables and files of results."""
