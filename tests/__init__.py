"""Tests; each file has the path of what it tests. What several of them need is in `helpers`."""
