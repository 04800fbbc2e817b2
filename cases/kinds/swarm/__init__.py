"""The kind of scenario "swarm": many vehicles that never collide."""
