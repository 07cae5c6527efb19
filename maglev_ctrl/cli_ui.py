"""`maglev-ctrl ui`: the workbench page on this machine; everything heavy is loaded inside."""
