"""Series of bags, each with a model of its own: months of one rig in one table."""
