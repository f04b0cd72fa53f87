"""What each command does: one call of the library, then what people and programs see of it."""
