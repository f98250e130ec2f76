"""MuJoCo's side of a `MujocoPlant`: its model, its steps, and the loop around them."""
