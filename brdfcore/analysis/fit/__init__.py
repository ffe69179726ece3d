"""The analytic model that stands for a measurement, and what it loses."""
