"""What tests share: sources, formulas, synthetic files, programs to start."""
