"""Laws for other programs: C99 source, MATLAB files and Python scripts, as text and bytes; nothing is written here."""
