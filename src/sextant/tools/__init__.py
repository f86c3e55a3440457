"""Tools that join several chapters: inspecting a folder, the demonstration, a walk with a camera."""
