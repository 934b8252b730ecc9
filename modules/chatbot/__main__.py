"""`python -m modules.chatbot`: answers to what is asked."""

from pathlib import Path

from modules.chatbot.task import Chatbot
from robotkit import main

main(Path(__file__).with_name("module.yaml"), Chatbot)
