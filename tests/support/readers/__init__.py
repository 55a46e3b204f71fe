"""What the program writes, read without it: pages, PDF, figures, texts of the repository."""
