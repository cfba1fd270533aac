"""What is plainly in another unit or of another sign than declared, found from the laws that every bridge obeys."""
