"""Models and rules written without the code that they check."""
