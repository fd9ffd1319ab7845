"""What runs a shard: a supervisor, and under it a simulator process and a policy process."""
