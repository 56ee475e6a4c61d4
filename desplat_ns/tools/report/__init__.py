"""A trained run on one HTML page, `page.write_report`: `pictures` renders photos, `views` judges
what they see of the scene, the template says what stands out, what to try, and why effects are."""
