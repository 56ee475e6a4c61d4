"""Looks at a capture before training and says which effects it calls for, with the evidence."""
