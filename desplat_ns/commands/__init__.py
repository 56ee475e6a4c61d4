"""The package's own commands, one file each: options and printing only.

`surveyed` is what `survey` does once its options are checked, `parser_words` reads the name and the
options of a data parser behind a command's own.

May import `scene`, `method_configs`, `pipeline`, `evaluation`,
`survey`, `photo_tourism`, `layouts`, `datamanager`, `runs`, `studies`, `reproduce`, `report`,
`export`, `process`, `fetch`, `training`, `data`, `backend`, `settings`, `files`, `console`, `cores`
and `errors`.
"""
