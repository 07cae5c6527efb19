"""The workbench: a local page where moving a slider shows the vehicle become unstable."""
