"""The live page: a server beside a rig, which it knows as any other program does."""
