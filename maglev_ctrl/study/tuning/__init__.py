"""Every option tuned by the same method against the same requirements, ranked, and the ranking's own sensitivity."""
