/** The user's token and role. The token is kept for this tab, or in this browser if the user asks for it. */
const STORAGE_KEY = "sparring.token";
/** Roles in ascending order: each has the permissions of those before it. */
const ROLES = ["viewer", "trainer", "admin"] as const;
export type Role = (typeof ROLES)[number];

function storedToken(): string | null {
  return sessionStorage.getItem(STORAGE_KEY) ?? localStorage.getItem(STORAGE_KEY);
}

class Session {
  token = $state(storedToken());
  /** True after the service has rejected a request without a valid token. */
  loginRequired = $state(false);
  /** Role of the token; null while it is unknown. */
  role = $state<Role | null>(null);

  logIn(token: string, remember: boolean) {
    (remember ? localStorage : sessionStorage).setItem(STORAGE_KEY, token);
    this.token = token;
    this.role = null;
    this.loginRequired = false;
  }

  logOut() {
    localStorage.removeItem(STORAGE_KEY);
    sessionStorage.removeItem(STORAGE_KEY);
    this.token = null;
    this.role = null;
    this.loginRequired = true;
  }

  /**
   * Asks for a token after the service has rejected a request with `token` (status 401). Nothing happens if the user has logged in with
   * another token since the request was sent.
   */
  reject(token: string | null) {
    if (token === this.token) this.loginRequired = true;
  }

  /** Reads the role from the detail of a 403 response, which ends with it. */
  readRole(detail: string) {
    this.role = ROLES.find((role) => detail.endsWith(` ${role}`)) ?? this.role;
  }

  /** Returns the reason why an action that needs `role` is unavailable; undefined if it is available or the role is unknown. */
  missingRole(role: Role): string | undefined {
    if (this.role === null || ROLES.indexOf(this.role) >= ROLES.indexOf(role)) return undefined;
    return `Requires a token of the role ${role}; yours is ${this.role}.`;
  }
}

export const session = new Session();
