//! Recipes and scenarios.

use std::collections::HashMap;
use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed};
use sqlx::{SqliteConnection, query};

use super::{StoreError, signed, to_json, unsigned};

/// Stores a recipe, once; its id.
///
/// # Errors
/// The database's.
pub async fn insert_recipe(conn: &mut SqliteConnection, recipe: &Recipe) -> Result<Vec<u8>, StoreError> {
    let id = recipe.id().0.to_vec();
    let body = to_json(&recipe.to_json())?;
    query!("INSERT INTO recipes (id, body) VALUES (?, ?) ON CONFLICT (id) DO NOTHING", id, body)
        .execute(conn)
        .await?;
    Ok(id)
}

/// Stores a scenario and its recipe, once each.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, scenario: &Scenario) -> Result<(), StoreError> {
    let recipe = insert_recipe(conn, scenario.recipe()).await?;
    let id = scenario.id().0.to_vec();
    let seed = signed(scenario.seed().get());
    query!(
        "INSERT INTO scenarios (id, recipe, seed) VALUES (?, ?, ?) ON CONFLICT (id) DO NOTHING",
        id,
        recipe,
        seed
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The seed of a scenario.
///
/// # Errors
/// The database's.
pub async fn seed(conn: &mut SqliteConnection, id: &[u8]) -> Result<Option<u64>, StoreError> {
    let seed =
        sqlx::query_scalar!("SELECT seed FROM scenarios WHERE id = ?", id).fetch_optional(conn).await?;
    Ok(seed.map(unsigned))
}

/// Reads scenarios, each recipe once.
#[derive(Debug, Default)]
pub struct Loader {
    recipes: HashMap<Vec<u8>, Arc<Recipe>>,
}

impl Loader {
    /// A scenario by its id.
    ///
    /// # Errors
    /// The database's, or a scenario that cannot be read.
    pub async fn get(&mut self, conn: &mut SqliteConnection, id: &[u8]) -> Result<Scenario, StoreError> {
        let row = query!("SELECT recipe, seed FROM scenarios WHERE id = ?", id).fetch_one(&mut *conn).await?;
        let recipe = self.recipe(conn, &row.recipe).await?;
        Ok(Scenario::new(recipe, Seed::new(unsigned(row.seed))?))
    }

    /// A recipe by its id.
    ///
    /// # Errors
    /// The database's, or a recipe that cannot be read.
    pub async fn recipe(
        &mut self,
        conn: &mut SqliteConnection,
        id: &[u8],
    ) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body = sqlx::query_scalar!("SELECT body FROM recipes WHERE id = ?", id).fetch_one(conn).await?;
        let value: serde_json::Value = super::from_json("a recipe", &body)?;
        let recipe = Arc::new(Recipe::from_json(&value)?);
        self.recipes.insert(id.to_owned(), Arc::clone(&recipe));
        Ok(recipe)
    }
}
