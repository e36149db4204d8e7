"""Who is in the image: one tracked person, several people, and their assignment over time."""
