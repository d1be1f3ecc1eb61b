"""Case files: the keys of each section, the rules that bind them, the gas that a case describes."""
