"""The paper's figures on docs/compare-with-desplat.md."""

from lab.reproduce.paper_tables import paper_table


def test_a_table_has_the_papers_figures_scene_by_scene():
    head, _, *rows = paper_table("A5").splitlines()
    assert head == "|  | Brandenburg Gate | Sacre Coeur | Trevi Fountain |"
    assert rows[-1].startswith("| DeSplat | 25.04 / 0.920 / 0.142 | 20.14 / 0.868 / 0.178 |")
