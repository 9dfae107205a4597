"""The realistic regime: causes as strong as devices show them, in data as laboratories take them.

`python -m tests.blind.realistic FOLDER --seed S --rounds N` draws files, diagnoses them and keeps
the score. The older study, of weak signals and first laws alone, is `tests.blind.study`.
"""
