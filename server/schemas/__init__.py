"""What the API gives out and takes in, and what the pages show: one model a noun.

Times are RFC 3339 in UTC. Rates are 0 to 1, with 95 % Wilson intervals.
"""
