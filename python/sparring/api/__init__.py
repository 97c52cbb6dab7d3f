"""What the API of a server takes and answers, and its operations."""
