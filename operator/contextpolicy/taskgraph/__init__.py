"""A policy's task graph as a picture (paper III, Figures 2 and 4). Pure: a policy in, text out.

Reading order: graph (what stands in the picture), mermaid (as text for Markdown), layout and svg (drawn).
"""
