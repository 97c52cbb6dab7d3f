"""Pictures, and the window they are shown in."""

from __future__ import annotations

from typing import Any

#: Pictures a second.
FPS = 10
#: Most pixels along one side.
MOST = 4096


class Screen:
    """How one environment is shown."""

    #: How many are shown now.
    _windows = 0

    def __init__(self, mode: str | None, size: tuple[int, int], metadata: dict[str, Any]) -> None:
        if mode is not None and mode not in metadata["render_modes"]:
            raise ValueError(f"render_mode: {mode!r} is none of {', '.join(metadata['render_modes'])}")
        try:
            width, height = (int(side) for side in size)
        except (TypeError, ValueError):
            raise ValueError(f"render_size: {size!r} is not a width and a height") from None
        if not (64 <= width <= MOST and 64 <= height <= MOST):
            raise ValueError(f"render_size: sides are from 64 to {MOST} pixels, not {width} and {height}")
        self.mode, self.width, self.height = mode, width, height
        self._window: Any = None
        self._clock: Any = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a picture, pixels."""
        return self.width, self.height

    def show(self, native: Any, env: int) -> Any:
        """The picture, where that is the mode; a window is filled with it otherwise."""
        if self.mode is None:
            import gymnasium

            gymnasium.logger.warn("render was called without a render_mode: make the environment with one, as rgb_array")
            return None
        pixels = native.render(env, self.width, self.height)
        if self.mode == "rgb_array":
            return pixels
        self._fill(pixels)
        return None

    def _fill(self, pixels: Any) -> None:
        try:
            import pygame
        except ImportError as error:
            from gymnasium.error import DependencyNotInstalled

            raise DependencyNotInstalled("pygame is not installed: pip install 'sparring[human]'") from error
        if self._window is None:
            pygame.display.init()
            Screen._windows += 1
            pygame.display.set_caption("Sparring")
            self._window = pygame.display.set_mode((self.width, self.height))
            self._clock = pygame.time.Clock()
        surface = pygame.surfarray.make_surface(pixels.swapaxes(0, 1))
        self._window.blit(surface, (0, 0))
        pygame.event.pump()
        self._clock.tick(FPS)
        pygame.display.flip()

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            import pygame

            # pygame has one window, which all share that are shown.
            Screen._windows -= 1
            if Screen._windows == 0:
                pygame.display.quit()
            self._window = None
