"""From measurements to estimated motions, and how far predictions can be trusted.

May import scenarios, settings, mathematics and files. Begin with `maximum_likelihood`, or with `kalman` for motions
with noise of their own; `motion_estimate` has the results. While driving, `estimators` has the estimator of one
obstacle, and `noticing` the filters of many that are watched for changes of their motions.
"""
