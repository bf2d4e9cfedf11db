"""How a task is kept, told, held back, carried out and taken up again after a crash."""
