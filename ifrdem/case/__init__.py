"""Case files: the keys of each section, the rules that bind them, the gas that a case describes.

`gas` has the gas of a case; functions of it are in `starts` (how it begins), `checks` (what is wrong with it) and
`notices` (what is worth a word).
"""
