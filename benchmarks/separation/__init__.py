"""How well static scene and distractors are told apart: the runs behind docs/separation.md."""
