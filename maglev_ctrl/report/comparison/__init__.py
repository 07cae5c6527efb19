"""Figures of options side by side: what each can reach where objectives conflict."""
