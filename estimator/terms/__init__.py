"""One term of the energy a file: value, gradient and Hessian in the tangent space, values of many poses; their sum."""
