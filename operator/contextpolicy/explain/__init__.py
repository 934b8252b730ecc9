"""Why a task has its share, as data and in sentences, and the policy's task graph as a picture (paper III, Figs. 2, 4).

Reading order: explanation, sentences; task_graph (what is in the picture), mermaid, graph_picture.
"""
