"""Code for compilers: lowering, batches, executables that are kept, messages to a device, timings."""
