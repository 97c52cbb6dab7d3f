/** Who looks: a token where the service has them, kept for this tab unless asked otherwise. */
const KEY = "sparring.token";
/** Each may what those before it may. */
const ROLES = ["viewer", "trainer", "admin"] as const;
export type Role = (typeof ROLES)[number];

function kept(): string | null {
  return sessionStorage.getItem(KEY) ?? localStorage.getItem(KEY);
}

class Session {
  token = $state(kept());
  /** The service has asked for a token. */
  needed = $state(false);
  /** What the token is good for, once that is known. */
  role = $state<Role | null>(null);

  enter(token: string, remember: boolean) {
    (remember ? localStorage : sessionStorage).setItem(KEY, token);
    this.token = token;
    this.role = null;
    this.needed = false;
  }

  leave() {
    localStorage.removeItem(KEY);
    sessionStorage.removeItem(KEY);
    this.token = null;
    this.role = null;
    this.needed = true;
  }

  /** Refusals name the role of who was refused. */
  refused(detail: string) {
    this.role = ROLES.find((role) => detail.endsWith(`yours is ${role}`)) ?? this.role;
  }

  /** Why what needs a role cannot be done; nothing where it can, or where nobody knows. */
  lacks(needed: Role): string | undefined {
    if (this.role === null || ROLES.indexOf(this.role) >= ROLES.indexOf(needed)) return undefined;
    return `This needs a token of the role ${needed}; yours is ${this.role}.`;
  }
}

export const session = new Session();
