"""The constrained step, mode seeking, hard clearance, covariance at a mode.

box_step, qp: a step within bounds, on a guessed active set or by ProxQP. seek: the damped Newton loop
(`estimator.numerics.newton`) with that step on the energy of a pose. contact: the same with signed distances as rows.
solution: what a search gives back, its status and which solvers solved its steps.
"""
