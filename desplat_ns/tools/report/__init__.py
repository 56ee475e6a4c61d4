"""A trained run on one HTML page, `page.write_report`: `pictures` renders photos, `views` judges
what they see of the scene, `notices` says what stands out and what to try."""
