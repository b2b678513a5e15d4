"""From registered frames to a method's problem: checks, noise, what frames agree on."""
