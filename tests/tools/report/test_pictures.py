"""A training photo's pictures."""

from desplat_ns.tools.report.pictures import training_photos


def test_a_photo_of_a_run_without_distractors_stands_beside_the_scene_alone(tiny_run, tmp_path):
    config = tiny_run(tmp_path).pipeline
    config.model.effects.distractors = False
    pipeline = config.setup(device="cpu")
    pipeline.eval()
    (photo,) = training_photos(pipeline, [1])
    assert photo.pictures.keys() == {"photo", "rendering"}
    assert photo.covered is None
