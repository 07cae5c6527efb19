"""What the workbench page shows: one option at the values of its sliders, fast first, verified after."""
