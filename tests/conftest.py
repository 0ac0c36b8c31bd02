from hypothesis import settings

# No deadline for a single example: on a busy machine it would fail tests of correct code.
settings.register_profile("project", deadline=None)
settings.load_profile("project")
