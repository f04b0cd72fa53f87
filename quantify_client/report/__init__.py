"""Results as files, pictures, a page and a table; nothing is computed here.

Only `figures` imports matplotlib and only `terminal` rich: inside WebODM neither is there.
"""
