"""What worlds are made of: spaces, layouts, sensors as wrappers, pictures."""
