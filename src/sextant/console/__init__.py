"""What commands share: arguments, what they show, where they write."""
