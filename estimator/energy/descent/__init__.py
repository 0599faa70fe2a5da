"""The constrained step, the damped Newton loop, mode seeking, hard clearance, covariance at a mode.

newton: the loop, of anything that has models and steps. box_step, qp: a step within bounds, on a guessed active set or
by ProxQP. seek: the loop with that step on the energy of a pose. contact: the same with signed distances as rows.
solution: what a search gives back, its status and which solvers solved its steps.
"""
